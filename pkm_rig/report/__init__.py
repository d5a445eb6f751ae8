"""What people and programs see of a result: terminal, HTML, pictures, JSON."""
