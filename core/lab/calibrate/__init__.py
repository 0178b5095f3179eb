"""What is off at a real bench, by photographs of a lattice; and from where its picture is seen."""
