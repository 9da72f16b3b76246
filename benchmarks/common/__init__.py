"""What benchmarks share: clock, reports, peers, fields, data, the engine in one face."""
