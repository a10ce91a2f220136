"""Real recordings with a real thing hidden, written from the shared recordings and never committed."""
