"""A map is renewed where a later flight saw the floor changed.

Old frames whose place the flight covers, and which it contradicts, are replaced. The rest stays,
and the parts of the method learn anew from what is left and what came.
"""

from dataclasses import replace

import numpy as np

from trexton.base.errors import MapError, ParameterError
from trexton.flights.flight import Flight, area_around
from trexton.localization.alike import are_shares, check_kind, fingerprints
from trexton.localization.texton_map import TextonMap
from trexton.localization.training import full_histograms, with_parts
from trexton.vision.camera import wrapped

KEPT = ("appearance", "odometry")  # roles that learned of the camera, not of the floor
APART_S = 0.5  # between frames that are compared; nearer ones show nearly the same
USUAL_SHARE = 0.95  # of frames of one place that differ by less than what contradicts
GAP_S = 1.0  # by which the later flight follows the map's: stretches left out lie in flights
MOST_TURNED = 0.5  # radians from the heading of the survey, in half of the frames


def renewed(
    texton_map: TextonMap, flight: Flight, *, rng: np.random.Generator
) -> tuple[TextonMap, int]:
    """The map with the frames of a later flight, and how many old ones they replaced.

    Raises
    ------
    TrextonError
        The method keeps pictures of the floor, the map has these frames, most lie beside it or
        nowhere, or their images or features are of another kind.
    """
    if texton_map.method == "fine":
        raise ParameterError("a map of method fine holds pictures: train it again on both flights")
    if not flight.located.any():
        raise MapError(f"flight {flight.name!r} has no frame with a position: it renews nothing")
    later = flight.select(flight.located)
    low, high = corners = np.reshape(texton_map.area, (2, 2)).T
    beside = ((later.position < low) | (later.position > high)).any(axis=1).mean()
    if beside > 0.5:
        found = f"{beside:.0%} of the positions of {flight.name!r} lie beside the map"
        raise MapError(f"{found}: give them from the same origin, or train on both flights")
    far = np.hypot(*(high - low))
    if ((later.position < low - far) | (later.position > high + far)).any():
        raise MapError(f"{flight.name!r} has positions far beside the map: leave them empty")
    check_kind(later, texton_map)
    _check_heading(later, texton_map)
    histograms = full_histograms(later, texton_map.dictionary, texton_map.cells)
    if are_shares(texton_map.histograms) != are_shares(histograms):
        found = f"of the map and of {flight.name!r} one holds relative frequencies"
        raise MapError(f"{found}, the other does not: divide counts by their sum")
    held = fingerprints(texton_map.positions, texton_map.histograms)
    again = len(held & fingerprints(later.position, histograms))
    if again > len(later) / 20:  # no left-out block would be without them
        raise ParameterError(f"{again} frames of {flight.name!r} are in the map: give a later one")
    old = ~contradicted(texton_map, histograms, later.position)
    start = texton_map.time[-1] + GAP_S - later.time[0]
    renewals = [*texton_map.provenance.get("renewed", []), [flight.name, flight.data_hash]]
    news = {"renewed": renewals, "assessment": None}  # not judged yet
    if names := texton_map.feature_names or list(flight.feature_names):
        news["features"] = names
    result = replace(
        texton_map,
        histograms=np.concatenate([texton_map.histograms[old], histograms]),
        positions=np.concatenate([texton_map.positions[old], later.position]),
        time=np.concatenate([texton_map.time[old], later.time + start]),
        area=area_around(np.concatenate([corners, later.position])),
        provenance=texton_map.provenance | news,
    )
    parts = {role: part.untrained() for role, part in texton_map.parts.items() if role not in KEPT}
    return with_parts(result, parts, rng=rng), int((~old).sum())


def _check_heading(later: Flight, texton_map: TextonMap) -> None:
    survey = getattr(texton_map.parts.get("appearance"), "survey_yaw", np.nan)
    yaw = np.nan if later.attitude is None else later.attitude[:, 2]
    off = np.abs(wrapped(yaw - survey)).ravel()
    off = off[np.isfinite(off)]
    if len(off) and (turned := float(np.median(off))) > MOST_TURNED:
        found = f"{later.name!r} was flown at {np.degrees(turned):.0f} degrees"
        raise MapError(f"{found} to the map's heading: fly it as the map was, or train anew")


def contradicted(texton_map: TextonMap, histograms: np.ndarray, places: np.ndarray) -> np.ndarray:
    """``(N,)`` whether the frame of a later flight that is nearest to each of the map's, and as
    near as those are to each other, looks more unlike it than they do.
    """
    positions, time = texton_map.positions, texton_map.time
    apart = np.hypot(*(positions[:, None] - positions).T)
    apart[np.abs(time[:, None] - time) < APART_S] = np.inf
    reach = float(np.median(apart.min(axis=1)))
    own, later = texton_map.histograms, histograms
    if (own < 0).any():  # values, in units of their deviations
        own, later = (each / np.maximum(own.std(axis=0), 1e-9) for each in (own, later))
    else:
        own, later = (np.sqrt(np.maximum(each, 0)) for each in (own, later))
    unlike = np.linalg.norm(own - own[apart.argmin(axis=1)], axis=1)
    distance = np.hypot(*(positions[:, None] - places).transpose(2, 0, 1))
    nearest, rows = distance.argmin(axis=1), np.arange(len(positions))
    differs = np.linalg.norm(own - later[nearest], axis=1)
    return (distance[rows, nearest] <= reach) & (differs > np.quantile(unlike, USUAL_SHARE))
