"""The virtual room: floor, vehicle and camera. It is live (`Simulator`), or recorded."""
