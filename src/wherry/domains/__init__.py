"""Domains: the schema, terms, actions and rewards of kinds of worlds, with grid environments of them."""
