"""The virtual room: floor, vehicle and camera; live as `Simulator`, or recorded as a Flight."""

from trexton.simulator.effects import Effects, Light
from trexton.simulator.floor import Floor
from trexton.simulator.layouts import LAYOUTS
from trexton.simulator.plans import Plan, random_waypoints, survey
from trexton.simulator.recording import PATTERNS, record_flight
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
