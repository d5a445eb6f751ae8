"""The comparison of two campaigns, on pairs of recordings whose change is known (docs/explanation/comparison.md)."""
