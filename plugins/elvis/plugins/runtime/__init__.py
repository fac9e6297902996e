"""Runtime plugins: what they tell (``source``, ``volume``), and the same data evaluated on the host."""
