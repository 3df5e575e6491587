"""States: angles, lattices, motion and the travel between them, positions of phalanges, anchors."""
