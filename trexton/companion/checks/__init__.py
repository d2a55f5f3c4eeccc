"""Speed and settings are measured here. ``bench`` prints ratios, ``tune`` searches settings."""
