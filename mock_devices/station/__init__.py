"""The mock station: telescope, GeoCOM answers, lines."""
