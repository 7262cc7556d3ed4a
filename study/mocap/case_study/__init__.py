"""The paper's case study: scatter of joint centres fitted to parts of a recording."""
