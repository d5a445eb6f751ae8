"""Results of the jobs, as the reports show them."""
