"""Where simulation and recording differ, which physics the simulation lacks, and the model that has it."""
