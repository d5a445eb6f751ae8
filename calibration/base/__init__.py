"""What everything computes with: arrays, errors, checked files, rotations and rigid motions."""
