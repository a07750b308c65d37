"""Floor plans: cells and walls, world files, and random buildings."""
