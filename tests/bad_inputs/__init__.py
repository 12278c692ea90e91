"""Bad inputs by the hundred: every class of input, every kind of damage, through the real commands.

python -m tests.bad_inputs --count 300 --seed 0
"""
