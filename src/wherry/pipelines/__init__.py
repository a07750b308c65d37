"""What commands run: deliveries, logs and grids, from checked settings to a result."""
