"""What survives when the host, the mock devices or one drive are killed in the middle of a campaign."""
