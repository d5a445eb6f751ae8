"""The one machine behind all mock devices: its true geometry, elasticity, temperatures and sight lines."""
