"""The ledger: claims of the paper and our tests of them. Fixed rules make the verdicts."""
