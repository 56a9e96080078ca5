"""Numbers of the page."""

# JPEG quality of images on the page: at 95 the error of a grey level is about that of the sensor's noise.
JPEG_QUALITY = 95
# Points of a curve: a whole circle is then drawn to 0.2 % of its radius, 1 - cos(pi / 47).
CURVE_SAMPLES = 48
# Decimals of metres on the page: a micrometre is a hundredth of a pixel at a tenth of a metre and 1,000 pixels.
DECIMALS = 6
# Seconds between signs of life to a listening browser, by which it is known that one has gone.
SIGN_OF_LIFE_S = 5.0
# Seconds after which a kind of message counts as no longer coming, and moments are shown without it.
SILENT_S = 2.0
# Moments that may wait for the rest of what belongs to them.
WAITING = 16
# The page of a live view or of a file stands here unless another port is asked for.
PORT = 8008
