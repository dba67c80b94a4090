"""Recursive identification of a live signal: blocks in, operational dynamic parameters out, with confidence."""
