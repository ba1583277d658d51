"""The bench that needs no hardware: servers that speak the real protocols over the physics, on one clock."""
