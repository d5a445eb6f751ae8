"""What every mock node on the CAN bus needs, and ways to that bus."""
