"""Experiments: Settings → run → Result; each makes figures that documents can quote."""
