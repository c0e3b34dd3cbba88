"""Rig files: read, checked, extended and written; laws and causes of one's own."""
