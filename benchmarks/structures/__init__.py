"""Test cases of drawn structure, without a named formula (docs/explanation/structures.md)."""
