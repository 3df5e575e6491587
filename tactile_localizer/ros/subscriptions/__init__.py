"""Subscriptions: strain, palm poses on a topic or in tf."""
