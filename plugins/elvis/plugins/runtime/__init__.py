"""Runtime plugins: their interface (``source``, ``volume``), and evaluation of their data on the host."""
