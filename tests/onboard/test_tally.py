"""Counting faults and latencies."""

from __future__ import annotations

from trexton.onboard.tally import Latencies


def test_latencies_in_constant_memory():
    latencies = Latencies(size=10)
    for value in range(100):
        latencies.add(value)
    assert latencies.longest == 99
    assert latencies.quantile(0) == 90 and latencies.quantile(1) == 99
