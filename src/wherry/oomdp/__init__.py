"""Object-oriented Markov decision processes: what a world is made of, and how it changes (paper, sections 2 to 4)."""
