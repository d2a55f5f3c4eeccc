"""Images, cameras, textons and their histograms, visual odometry."""
