"""Reports of diagnoses: where a recording and a simulation differ, what is missing, how the fit improves with it."""
