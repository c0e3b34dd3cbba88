"""The commands of ``hbm``: their options, what they print while they work, and the tables they end with."""
