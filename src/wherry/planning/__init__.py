"""Planners on any model, true or learnt, one file each (paper, section 6)."""
