"""What it costs: `make bench`, or `python -m benchmarks [SUBJECT ...]` from the checkout.

One file a subject, each with `run()` that prints a table; nothing here fails because it is slow.
"""
