r"""Free rollouts: the judge of what is said of an identified model.

A fit is told when the recordings switch, or finds it out with the laws; whoever uses the model has
its own guards alone. So the delivered model is rolled out from each recording's estimated start,
modes told by its own guards, and what that leaves of the samples, :math:`e_i = (y_i - x(t_i)) /
\sigma_i`, says whether laws and guards hold. Data in: a model that simulates, `Course` by course
(samples, start, switches as identified), and the noise. Data out: `FreeRollouts`.

- `courses`: what is rolled out, and the switches of both sides;
- `sample_noise`: the noise of every sample, which may grow with the value or differ by recording;
- `breaks`: where what is left is no longer noise, by Page's test;
- `judge`: the rollouts and the judgement, with its sentence.
"""
