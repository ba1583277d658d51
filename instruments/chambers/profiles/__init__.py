"""The profiles shipped with the drivers, one TOML file per controller."""
