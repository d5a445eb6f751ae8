"""The station: GeoCOM on a serial line."""
