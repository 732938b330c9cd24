"""The paper's t(I): an auto-encoder that paints edge images, how it is trained, and the edge points read off them."""
