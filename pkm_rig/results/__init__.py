"""Results of the jobs, as the reports show them."""

__all__ = [
    "callbacks",
    "diagnosis_attempt",
    "done",
    "dry_run",
    "estimate",
    "outcome",
    "report_source",
    "standard_results",
    "unknowns",
]
