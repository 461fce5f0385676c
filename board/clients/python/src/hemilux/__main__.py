"""python -m hemilux: the command hemilux-lights."""

from .command import main

main()
