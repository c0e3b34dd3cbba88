"""What a diagnosis is worth on blind cases: sets, runs, rules, rates, ceiling, figures; `benchmarks/diagnosis.py`."""
