"""Images and cameras become textons and histograms. Visual odometry stands beside them."""
