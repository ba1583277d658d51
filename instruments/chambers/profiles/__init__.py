"""The profiles that come with the drivers, one TOML file a controller."""
