"""The commands, one file each: parse, call, print. What computes is imported inside them, so that --help is quick."""
