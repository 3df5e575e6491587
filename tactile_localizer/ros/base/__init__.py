"""What every node is made from: lifecycle, parameters, guarded callbacks."""
