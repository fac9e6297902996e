"""Line integral convolution."""
