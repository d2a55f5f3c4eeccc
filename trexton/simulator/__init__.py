"""The virtual room: floor, vehicle and camera; live as `Simulator`, or recorded as a Flight."""

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
