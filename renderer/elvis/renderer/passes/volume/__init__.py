"""Volumes: what elements send out and take up along each ray."""
