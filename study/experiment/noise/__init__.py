"""The noise of samples: Gaussian laws, and departures from them: other laws and outliers."""
