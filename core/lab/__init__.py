"""What uses the solver: measurements, maps, jobs, drawings, and calibration by photographs."""
