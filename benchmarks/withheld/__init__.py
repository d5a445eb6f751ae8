"""Checks a diagnosis on data whose truth is withheld (docs/explanation/withheld.md)."""
