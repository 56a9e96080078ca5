"""Numbers of the page."""

# Decimals of metres on the page: a micrometre is a hundredth of a pixel at a tenth of a metre and 1,000 pixels.
DECIMALS = 6
# Seconds after which a kind of message counts as no longer coming, and moments are shown without it; and between signs
# of life to a listening browser, by which it is known that one has gone.
SILENT_S = 2.0
# The page of a live view or of a file stands here unless another port is asked for.
PORT = 8008
