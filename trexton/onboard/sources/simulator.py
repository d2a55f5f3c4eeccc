"""The virtual room, live: a vehicle on random waypoints, and what its camera sees."""

from __future__ import annotations

import re
from collections.abc import Iterator

from trexton.base.errors import ParameterError
from trexton.base.streams import stream
from trexton.onboard.sources.base import Expected, Frame, Playback, Source
from trexton.onboard.sources.recorded import Recording

__all__ = ["SimulatorSource"]


class SimulatorSource(Recording):
    """A flight without end over the painted hall, a frame each time it is asked for one.

    Parameters
    ----------
    seed : int

    Attributes
    ----------
    simulator : trexton.simulator.Simulator
    """

    pace = "stamps"

    addresses = {
        "simulator": "the virtual room, live",
        "simulator:7": "the same with another seed",
    }

    @staticmethod
    def matches(address: str) -> bool:
        return address == "simulator"

    @classmethod
    def make(cls, address: str, options: Playback, around: Expected) -> Source:
        seed = re.fullmatch("[0-9]{1,9}", address)
        if address not in ("", "simulator") and not seed:
            raise ParameterError(
                f"camera 'simulator:{address}': "
                "give simulator or simulator:SEED with a whole number"
            )
        return cls(int(address) if seed else around.seed)

    def __init__(self, seed: int = 1):
        from trexton.simulator import Floor, Plan, Simulator, random_waypoints

        super().__init__()
        plan_rng, simulator_rng = stream(seed, "simulator").spawn(2)
        floor = Floor.hall()
        self._plan = Plan(random_waypoints(floor.area, plan_rng))
        self.simulator = Simulator(floor, start=self._plan.start, speed=0.6, rng=simulator_rng)

    def lap(self) -> Iterator[Frame]:
        while True:
            state = self.simulator.step(self._plan.goal(self.simulator.state.position))
            yield Frame(state.time, self.simulator.render())
