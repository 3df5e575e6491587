"""Subscriptions to strain and palm poses, on a topic or from tf."""
