"""The virtual room: floor, vehicle and camera. It is live (`Simulator`), or recorded."""

from trexton.simulator.floor import LAYOUTS, Floor, Light
from trexton.simulator.recording import PATTERNS, Plan, random_waypoints, record_flight, survey
from trexton.simulator.sensor import Effects
from trexton.simulator.simulator import PERIOD, Simulator
from trexton.simulator.vehicle import Vehicle, VehicleState

__all__ = [
    "Effects",
    "Floor",
    "LAYOUTS",
    "Light",
    "PATTERNS",
    "PERIOD",
    "Plan",
    "Simulator",
    "Vehicle",
    "VehicleState",
    "random_waypoints",
    "record_flight",
    "survey",
]
