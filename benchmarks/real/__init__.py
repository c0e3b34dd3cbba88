"""The measured sets of ``shared/data``, one module each; `benchmarks/real_data.py` runs them all."""
