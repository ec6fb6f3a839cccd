"""How closely two numbers must agree, and why not more closely."""

# printed with 15 digits, or computed with 50
VECTOR = 1e-12
# the reference adds in another order; with an offset of 1e9 it loses seven digits itself
PARITY = 1e-10
PARITY_WITH_OFFSET = 1e-6
# scipy.stats has about twelve digits in the tails
DISTRIBUTION = 1e-11
