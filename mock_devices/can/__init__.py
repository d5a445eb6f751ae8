"""What every mock node on the CAN bus needs, and ways to that bus."""

__all__ = [
    "faulty_bus",
    "node_services",
    "node_watch",
    "pdo",
    "pdo_traffic",
    "sdo_abort",
    "sdo_server",
    "slcan_adapter",
    "socketcand_server",
    "sync_moments",
]
