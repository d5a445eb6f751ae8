"""The laser station: GeoCOM on a serial line."""
