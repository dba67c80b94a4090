"""The blind generator of concealed cases: numpy, scipy and numba only.

It shares no code with the program that is put to the test - no force laws, no integrator, no noise, no sensor - so that
a mistake made once cannot confirm itself (no inverse crime). An import contract in pyproject.toml holds this.
"""
