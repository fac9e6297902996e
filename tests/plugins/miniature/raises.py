"""A plugin module whose import fails."""

raise RuntimeError("the licence of raises has expired")
