"""Any programs beside one another on recordings whose cause is known (docs/how-to/enter-gapbench.md)."""
