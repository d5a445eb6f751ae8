"""What jobs end with and reports show."""
