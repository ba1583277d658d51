"""The way to instruments with a network address: names, routes, ports, firewalls."""
