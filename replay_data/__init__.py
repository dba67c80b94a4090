"""Simulated recordings for the demonstration and the tests, and what makes them."""
