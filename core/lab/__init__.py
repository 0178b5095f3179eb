"""Tools on top of the solver: measurements, maps, jobs, drawings, calibration by photographs."""
