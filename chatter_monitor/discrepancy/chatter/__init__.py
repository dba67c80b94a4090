"""A cut that chatters though its model is stable: its growth, its limit, and what is said of it."""
