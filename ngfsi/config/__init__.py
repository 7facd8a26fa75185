"""What cases and files are read with: models with units in their keys, messages, functions of time."""
