"""Questions asked of several model classes."""
