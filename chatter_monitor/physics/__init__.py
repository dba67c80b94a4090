"""Machining systems as composable physics: terms, models, simulation, stability."""
