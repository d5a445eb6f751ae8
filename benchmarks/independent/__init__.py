"""The diagnosis on recordings of another simulator (docs/explanation/independent.md)."""
