"""The ledger: claims of the paper, our tests of them, verdicts by fixed rules."""
