"""Other senses: methods that were made for textons, on the signals of radio beacons.

The public Bluetooth walks take the place of the flight; training and defaults are as for textons.
"""

from dataclasses import dataclass

from trexton.base.errors import DataError
from trexton.base.progress import say
from trexton.base.records import Record
from trexton.companion.experiments import baselines
from trexton.companion.experiments.declaration import Experiment
from trexton.companion.public_flights import read_ble
from trexton.companion.wording import beside, distance, middle, percent
from trexton.flights.flight import Flight
from trexton.flights.registry import locate

GRID_FILTER_CM = 176.0  # mean error of a Gaussian process a receiver with a grid filter
CLAIMS = (
    {
        "id": "senses-error",
        "place": "this project",
        "measure": "mean error (cm)",
        "text": "On radio method field is as good as Gaussian processes with a grid filter",
        "kind": "below",
        "bound": GRID_FILTER_CM,
        "ours": "senses:field.mean_cm",
        "data": "Walks with a radio beacon (real)",
        "needs": "the public Bluetooth walks",
    },
)


@dataclass(frozen=True)
class Parameters(baselines.Parameters):
    """What can be chosen."""


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Train on seven walks and locate the frames of two others, with every method.

    The flights are not used; they name the record.
    """
    try:
        walks = read_ble(*locate("ble"))
    except DataError as error:
        say(str(error))
        return parameters.record(train, values={"absent": True, "exchanged": None})
    values, step_ms = baselines.compare(walks.part("train"), walks.part("test"), parameters)
    values |= {"absent": False, "exchanged": None}
    return parameters.record(train, values=values, timings={"step_ms": step_ms})


def finding(record: Record) -> str:
    """What the experiment found, in a sentence or two."""
    if record.values["absent"]:
        return (
            "The public Bluetooth walks were not there, and could not be fetched. Go online, or "
            "set `TREXTON_DATA` to a folder that holds their files, and run this again."
        )
    field, ratio = record.values["field"], beside(record.values["ratio"])
    best = f"that of the best simple baseline, the {baselines.LABELS[record.values['best']]}"
    covers = f"covers {percent(middle(field['held']))} of the positions"
    error = distance(field["mean_cm"])
    return f"The mean error of method field is {error}, {ratio} {best}. Its 90 % region {covers}."


EXPERIMENT = Experiment(
    "Other senses: the same method on radio",
    Parameters,
    run,
    finding,
    needs=("histograms",),
    cost_s=10,
    claims=CLAIMS,
)
