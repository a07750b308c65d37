"""Where the two halves meet: what is sensed becomes a State, and an Action becomes motion (paper, section 7)."""
