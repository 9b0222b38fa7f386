"""Files of every format, damaged and forged at random, and what becomes of them."""
