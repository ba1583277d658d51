"""Metrology of a gyro: its deviations over averaging times, the noise behind them, and acceptance tests."""
