"""The commands, one file each: parse, call, print.

Commands import what computes inside their functions, so that ``wherry --help`` starts quickly.
"""
