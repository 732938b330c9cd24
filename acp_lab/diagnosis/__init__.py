"""Why a frame went wrong: what it shows of the part, which causes fit that, and words for them."""
