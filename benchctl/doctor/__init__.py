"""`benchctl doctor`: check the disk, serial ports, network and instruments; every finding states what to do."""
