"""The ledger: every claim of the paper, what it printed, our test of it, a verdict by a fixed rule.

Three things stay apart: what the paper says (`Claim.text`, `Claim.place`), the value it printed
(`Claim.printed`, empty where it printed none), and this project's test (`Claim.measure` and the
rule of its kind, in `trexton.companion.claims.rules`).
"""

from trexton.companion.claims.ledger import (
    Claim,
    Finding,
    count_verdicts,
    judge,
    judge_all,
    load_claims,
    load_records,
    write_ledger,
)
from trexton.companion.claims.rules import VERDICTS, Quantity

__all__ = [
    "Claim",
    "Finding",
    "Quantity",
    "VERDICTS",
    "count_verdicts",
    "judge",
    "judge_all",
    "load_claims",
    "load_records",
    "write_ledger",
]
