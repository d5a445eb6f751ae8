"""What a diagnosis says: where the gap lies, how large its causes are, how far it shrinks, what to measure next."""
