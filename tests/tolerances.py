"""How closely two numbers must agree, and why not more closely."""

# printed with 15 digits, or computed with 50
VECTOR = 1e-12
# the reference adds in another order; with an offset of 1e9 it loses seven digits itself
PARITY = 1e-10
PARITY_WITH_OFFSET = 1e-6
# scipy.stats has about twelve digits in the tails
DISTRIBUTION = 1e-11
# the reference inverts covariances of condition numbers up to about 100
INVERSES = 1e-12
# covariances in units that are no powers of two are rounded, and have condition numbers up to 30
UNITS = 1e-13
# sensors of condition numbers up to 1e3, a thousand times apart, found by hypothesis
IDENTITIES = 1e-9
# (14) to (20) in another order of the operations, in units of the standard deviations
STATE = 1e-11
# the textbook's smoother inverts predicted covariances, whose condition is about 1e4
SMOOTHED = 1e-9
# against 60 digits
EXACT_STATE = 1e-12
# least squares of powers, whose condition is about 1e4, in units of the standard errors
POLYNOMIAL = 1e-10
# against 300 digits, in units of the standard deviations
TRACK = 1e-9
# tracks of plots of 15 to 100 m, 60 km away: least squares by another way, Joseph's form, mixtures
# about their means; in units of the standard deviations, so that it is 1e-8 m of 100 m
PLOTS = 1e-10
# the chance that a correct estimate fails a test by Monte Carlo, were its seed not fixed
CHANCE = 0.01
