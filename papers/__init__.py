"""Tables and figures of five papers beside ours, judged by criteria that were fixed first.

It is part of a checkout, not of the wheel; `twin reproduce` runs it.
"""
