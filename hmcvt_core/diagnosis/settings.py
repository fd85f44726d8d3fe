# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Thresholds, priors and counts of the inference, with their sources.

"Chosen on development campaigns" means simulated campaigns whose seeds the published blind trial
does not use; `python -m studies.blind.sensitivity` halves and doubles any of these values, and
`docs/studies/sensitivity.md` says what that changes. Parts are fractions; deviations are standard
deviations of one reading; sizes are in typical sizes of an effect; log evidence is in nats.
"""

import math

# --- throughout -----------------------------------------------------------------------------

LIKELY = 0.5
"""Probability above which something is more likely than not.

Source: by definition. A rare campaign is no gap if its probability of an exact base is above it; a
gap is unexplained if that of an unlisted cause is.
"""

DRAWS = 999
"""Simulated campaigns without a gap, campaigns drawn from the samples, draws from a posterior.

Source: chosen; resolves a probability of a thousandth.
"""

LEADING_SETS = 4
"""Sets that are extended by one effect, refitted exactly, compete with a discrepancy, or reported.

Source: chosen on development campaigns, for speed. So many effects compete with the sign they
cannot have, too.
"""

FIXED_POINT_ROUNDS = 20
"""Maximum number of rounds of a fixed point: of noise variances, or of amplitudes with them.

Source: chosen as a guard against endless iteration.
"""

ROUNDING = 1e-9
"""Part, probability, information or deviation that counts as zero.

Source: rounding.
"""

# --- observations ---------------------------------------------------------------------------

SMALL_CAMPAIGN = 16
"""Samples below which scatter has no shape to judge by, only a size.

Source: chosen on development campaigns. Below it stated noise gets more weight, no outlier is
looked for, and the size of the scatter is tested too.
"""

MAX_SAMPLES = 1000
"""Maximum number of samples of a campaign that are used.

Source: limit of computing time and memory. More samples allow finer regions.
"""

REPLICATE_TOLERANCE = 0.002
"""Fraction of the range of an axis within which points repeat one point.

Source: chosen; a bench never sets a point twice to the last digit. A larger part takes neighbouring
points for repeats and so a gap between them for noise.
"""

TIE_TOLERANCE = 1e-6
"""Fraction of the largest value, or of the extent, within which coordinates are equal.

Source: chosen, between the last digits of a table and how closely a bench sets a point. On a plan
of even steps many samples are equally far from a sample or an edge; the last digits of the inputs
must not decide between them.
"""

REPLICATES_NEEDED = 5
"""Degrees of freedom of repeated points from which they state the noise.

Source: chosen on development campaigns. With fewer the assumed noise is used.
"""

MIN_REPLICATE_NOISE = 1e-5
"""Fraction of the largest reading below which agreement of repeats is a copy, not a measurement.

Source: chosen; readings that agree better than any bench are copied, or placeholders in a plan.
"""

SMOOTH_DEGREE = 3
"""Total degree of the polynomials that count as smooth over a campaign.

Source: chosen on development campaigns. A higher degree lets smooth discrepancies follow narrow
gaps.
"""

RECORDED_DEGREE = 2
"""Total degree of smooth functions in which an axis takes part that is only recorded.

Source: chosen; an oil temperature or a stage bends a loss, and changes it with stroke or speed.
"""

PRIOR_DOF_STATED = 8.0
"""Prior degrees of freedom of a stated noise: how many samples the statement is worth.

Source: chosen on development campaigns. More makes a wrong statement harder to correct.
"""

PRIOR_DOF_ASSUMED = 1.0
"""Prior degrees of freedom of an assumed noise.

Source: one sample, so that the data decide.
"""

PRIOR_DOF_STATED_SMALL = 30.0
"""Minimum prior degrees of freedom of a stated noise in a campaign below `SMALL_CAMPAIGN`.

Source: chosen on development campaigns; so few samples cannot correct a statement.
"""

PRIOR_DOF_ASSUMED_SMALL = 3.0
"""Minimum prior degrees of freedom of an assumed noise in a campaign below `SMALL_CAMPAIGN`.

Source: chosen on development campaigns: a bench twice as noisy as assumed raises no alarm by the
size of its scatter, one six times as noisy does.
"""

# --- preparation ----------------------------------------------------------------------------

MIN_SAMPLES = 5
"""Samples below which no diagnosis is made.

Source: chosen. A system with more base parameters needs one sample more than it has of them.
"""

MAX_WITHOUT_ANSWER = 0.25
"""Fraction of the samples without an answer of the model above which a campaign is refused.

Source: chosen; so many point to wrong units or to another machine.
"""

NAMED_SAMPLES = 3
"""Samples that a note describes one by one.

Source: length of a sentence.
"""

THINNING_REFINEMENT = 1.05
"""Ratio of the resolutions of successive lattices when a campaign is thinned.

Source: chosen. A smaller ratio spreads the kept samples more evenly and takes longer.
"""

THINNING_FINEST = 250.0
"""Cells along an axis of the finest lattice when a campaign is thinned.

Source: limit of computing time.
"""

OUTLIER_NEIGHBOURS = 6
"""Nearest neighbours with whose residuals that of a sample is compared.

Source: chosen on development campaigns. More of them make narrow gaps look like outliers.
"""

OUTLIER_DISTANCE = 5.0
"""Robust deviations from its neighbours above which a sample is an outlier.

Source: chosen on development campaigns. Fewer leave out sound samples.
"""

OUTLIER_RATIO = 10.0
"""Ratio to the largest usual distance above which a sample is an outlier where many lie far off.

Source: chosen on development campaigns; one gross slip bends the fit at other samples.
"""

MIN_OUTLIER_SCALE = 0.01
"""Minimum scale of the distance from neighbours, in deviations.

Source: chosen; neither a refit nor a bench comes nearer.
"""

MAX_OUTLIER_FRACTION = 0.03
"""Fraction of the samples above which outliers are a narrow gap instead.

Source: chosen on development campaigns.
"""

OUTLIER_CLUSTER_P = 0.01
"""p value below which outliers of a large campaign lie together, as a gap does.

Source: chosen; Kolmogorov-Smirnov test along each axis.
"""

MAD_TO_DEVIATION = 1.4826
"""Standard deviation of a normal variable divided by its median absolute deviation.

Source: quantile of the normal distribution.
"""

UNEVEN_NOISE_ROUNDS = 5
"""Maximum number of refits of the variance function of a channel.

Source: chosen on development campaigns.
"""

UNEVEN_NOISE_POINTS = 2.0
"""Distinct points for each function projected out from which a variance function is fitted.

Source: chosen on development campaigns.
"""

# --- fitting --------------------------------------------------------------------------------

HIGHEST_MISFIT = 1e5
"""Root mean square of the residuals of the refitted model [deviations] that is refused.

Source: squares of more, beside priors of one, lose the digits of double precision.
"""

HIGHEST_SENSITIVITY = 1e7
"""Change of the readings by a prior deviation of a base parameter [deviations] that is refused.

Source: as of `HIGHEST_MISFIT`: its square leaves two digits of a prior of one.
"""

NO_ANSWER = 100.0
"""Deviations charged for each reading that a hypothesis cannot predict.

Source: more than a usual misfit; a step of a refit charges at least the largest one, otherwise it
drops the worst points of a large gap.
"""

SIGNATURE_SIZE = 0.1
"""Size at which the signature of an effect is taken.

Source: chosen; a refit leaves little of an effect, so the slope at a small size counts.
"""

INVISIBLE_SIGNATURE = 1e-3
"""Deviations below which an effect of typical size is invisible in every channel.

Source: chosen; such an effect has no channel to show in.
"""

REFIT_STEPS = 60
"""Maximum number of steps of a refit.

Source: chosen as a guard against endless iteration.
"""

ROUGH_REFIT_STEPS = 6
"""Maximum number of steps of a rough refit of a candidate.

Source: chosen on development campaigns, for speed.
"""

STEP_PARTS = (1.0, 0.5, 0.2, 0.05, 0.01)
"""Parts of a Gauss-Newton step that the line search tries, in order.

Source: chosen on development campaigns.
"""

NEGLIGIBLE_STEP = 0.3
"""Deviations: a step that changes less, or gains less than its square, is not made.

Source: chosen; its square is 0.09, or 0.045 nats.
"""

CONVERGED_STEP = 0.01
"""`NEGLIGIBLE_STEP` of the refits that are reported and served.

Source: chosen; where such a refit ends then changes no printed figure.
"""

BASE_DIFFERENCE = 1e-5
"""Step of finite differences by base parameters, in scaled variables.

Source: chosen, between rounding and curvature.
"""

SIZE_DIFFERENCE = 1e-3
"""Step of finite differences by sizes and shapes.

Source: chosen, between rounding and curvature.
"""

AUXILIARY_VARIANCE_RATIO = 9.0
"""Minimum variance of auxiliary channels in the served fit, in units of their noise variance.

Source: three deviations. More makes the served channels fit better at the cost of the others.
"""

SHAPE_PRIOR_MEAN = 0.5
"""Prior mean of a free shape, as a part of its range.

Source: the middle of the range.
"""

SHAPE_PRIOR_SPREAD = (2.0 * math.pi) ** -0.5
"""Prior deviation of a free shape, as a part of its range.

Source: the normal prior then has the density of the uniform one at its mean.
"""

NOISE_TOLERANCE = 2e-3
"""Relative change of the noise variances at which their fixed point has converged.

Source: chosen; the evidence is stationary in the noise, so its error is of second order.
"""

FOLDS = 12
"""Folds of a cross-validation.

Source: chosen; the usual range is 5 to 20.
"""

FOLD_ASSIGNMENTS = 8
"""Random assignments of samples to folds that are averaged.

Source: chosen; one assignment is chance.
"""

# --- detection ------------------------------------------------------------------------------

GAP_SIGNIFICANCE = 0.02
"""p value up to which a gap counts.

Source: chosen; chance alone shows as much in one campaign of fifty.
"""

CERTAIN_GAP = 1.0 / 150.0
"""Probability of no gap up to which there is one, however rare its largest pattern is.

Source: a Bayes factor of 150 is very strong evidence (Kass & Raftery 1995, J. Am. Stat. Assoc. 90,
773). Few tests show no single pattern, and an explanation of all of them nevertheless.
"""

REGION_SIGNIFICANCE = 0.10
"""Probability of the opposite sign of the mean gap up to which a region is reported.

Source: chosen; the sign of a region is then certain at 90 %.
"""

MIN_REGION_FRACTION = 0.1
"""Fraction of the largest mean of a region below which the mean of another is not reported.

Source: chosen for reading.
"""

MIN_REGION_DIGITS = 10.0
"""Steps of the last printed digit below which the mean of a region is not reported.

Source: chosen for reading; 0.1 points of efficiency.
"""

NULL_BATCH = 64
"""Simulated campaigns that are handled at once.

Source: limit of memory. No effect on results.
"""

REGION_SAMPLES = 4
"""Minimum number of samples of a region in a campaign of 32 and more.

Source: chosen on development campaigns.
"""

SAMPLES_PER_REGION_SAMPLE = 8
"""Samples of a smaller campaign for each sample that a region needs.

Source: continues `REGION_SAMPLES` below 32 samples.
"""

BAND_EDGES = 21
"""Maximum number of inner edges of bands along one axis.

Source: limit of computing time. More give narrower regions.
"""

CORNER_EDGES = 6
"""Maximum number of inner edges along each axis of boxes over several axes.

Source: limit of computing time.
"""

ABSORBED_FRACTION = 1e-6
"""Fraction of the square of a pattern below which a refit absorbs all of it.

Source: rounding in single precision.
"""

REGION_GAIN = 0.03
"""Gain of the F1 score from which a further region is reported.

Source: chosen on development campaigns.
"""

MAX_REGIONS = 5
"""Maximum number of regions reported.

Source: length of the report.
"""

AGREEMENT_LEVEL = 0.02
"""Family-wise p value up to which readings disagree with their stated noise.

Source: as `GAP_SIGNIFICANCE`.
"""

NOISE_STATEMENT_TOLERANCE = 1.1
"""Ratio of true to stated noise up to which a statement holds.

Source: a standard deviation from fifty readings is known to 10 % (JCGM 100:2008, table E.1).
"""

SCATTER_AMPLITUDES = tuple(0.3 * 10.0 ** (step / 20.0) for step in range(41))
"""Amplitudes of a quantity that was not recorded, in stated deviations of a reading.

Source: chosen, 0.3 to 30; below, nothing shows, above, no bench would be used. They are 12 % apart:
the log evidence of a hundred tests falls by 0.3 where the nearest amplitude is 6 % off, and by 20
where it is off by a factor of 1.7.
"""

SCATTER_TIMES = (120.0, 400.0, 1200.0, 3600.0, 10800.0, 32400.0)
"""Times over which such a quantity varies [s].

Source: chosen, a factor of three apart, from minutes to a working day.
"""

SCATTER_SAMPLES = 300
"""Maximum number of samples whose scatter is attributed.

Source: limit of computing time.
"""

# --- discrepancy ----------------------------------------------------------------------------

SIZE_SPREADS = (0.5, 1.5, 5.0)
"""Prior deviations of a size, in typical sizes; equally likely.

Source: chosen, about a factor of three apart around the typical size.
"""

FORM_ALLOWANCE = 0.07
"""Prior median of the error of a form along an axis, as a part of its signature.

Source: families of forms in the literature leave of each other between 0.02, as power laws do once
their exponents agree, and 0.25, as films that break do (docs/diagnosis-method.md).
"""

FORM_ALLOWANCES = (0.5 * FORM_ALLOWANCE, FORM_ALLOWANCE, 2.0 * FORM_ALLOWANCE)
"""Prior deviations of a form error that looks like another effect, as parts of what bends.

Source: `FORM_ALLOWANCE`, known within a factor of two.
"""

MIN_FORM_ERROR_MATCH = 0.9
"""Fraction of the squared change by an effect from which it may be a form error of other forms.

Source: chosen. The rest is a change between channels, which no bend makes.
"""

AMPLITUDE_LOG_DEVIATION = 2.0 * math.log(2.0)
"""Prior deviation of the log variance of a fitted amplitude.

Source: chosen; an amplitude is known within a factor of two. Forms then span 0.02 ... 0.25 at two
deviations.
"""

MAX_FAMILIES = 8
"""Maximum number of families of functions that one selection adds.

Source: limit of computing time.
"""

BASE_AMPLITUDE_LIMIT = math.exp(AMPLITUDE_LOG_DEVIATION)
"""Amplitude of the base discrepancy [of its scale] up to which the base model is a little off.

Source: two prior deviations of an amplitude, a factor of four. What is larger is a loss that the
set misses.
"""

AMPLITUDE_TOLERANCE = 0.03
"""Change of the log evidence [nats] in a round at which the amplitudes have converged.

Source: chosen, well below what distinguishes two explanations.
"""

AMPLITUDE_START = 3.0
"""Log variance from which an amplitude is fitted, in its prior deviations.

Source: the upper end of the prior. From the median, one fit of six to a large gap ended more than 3
nats below the best of nine starts; from here one of fifty, in fewer rounds.
"""

MAX_AMPLITUDE_STEP = 3.0
"""Largest change of a log variance in a round.

Source: chosen as a guard against overshooting.
"""

FORM_ALLOWANCE_DEGREE = 2
"""Total degree of the polynomials by which a form may bend where one channel is read.

Source: chosen on development campaigns. With more channels it is `SMOOTH_DEGREE`: a form error
is then held by all of them.
"""

EXTRA_DISCREPANCY_FRACTION = (0.06, 0.2)
"""Parts of the squared change by an extra discrepancy: due to inexact forms up to, a cause from.

Source: the square of the largest form allowance, once and with a factor of nearly two along it.
"""

MISSED_FRACTION = (0.19, 0.38)
"""Parts of the squared change that a set misses by itself: due to its forms up to, a cause from.

Source: the square of the largest form allowance along three axes, once and twice.
"""

SCATTERED_FRACTION = (max(FORM_ALLOWANCES) ** 2, 2.0 * max(FORM_ALLOWANCES) ** 2)
"""Parts of the squared gap that scatter above their statement: negligible up to, a loss from.

Source: the square of the largest form allowance, once and twice; what forms miss is as large. It is
a part of the gap, so that more samples do not make a named cause weaker.
"""

EXPLAINED_BY_SET = (1.0, 0.01)
"""How far a set explains the gap at the two ends of the ranges above.

Source: chosen.
"""

# --- search ---------------------------------------------------------------------------------

PROPOSALS = 6
"""Proposals that are refitted of each group, and further forms that a screen adds to the best.

Source: chosen on development campaigns, for speed.
"""

EQUAL_EVIDENCE = 1e-3
"""Difference of log evidence [nats] up to which two forms are equal, so that the first counts.

Source: chosen; forms that are one curve on the tests of a campaign differ by rounding alone.
"""

EXCHANGES = 1
"""Other forms, and other effects, that are tried in place of an effect.

Source: chosen on development campaigns, for speed.
"""

EXCHANGE_ROUNDS = 3
"""Rounds in which effects of leading sets are exchanged.

Source: chosen on development campaigns, for speed.
"""

EXCHANGED_SETS = 2
"""Leading sets whose effects are exchanged.

Source: chosen on development campaigns, for speed.
"""

NEAR_BEST_FRACTION = 0.7
"""Fraction of the best gain in log evidence that a candidate has to reach, less `NEAR_BEST_MARGIN`.

Source: chosen on development campaigns. Less keeps more candidates at the cost of time.
"""

NEAR_BEST_MARGIN = 4.0
"""Log evidence that a candidate may lie below `NEAR_BEST_FRACTION` of the best gain.

Source: chosen on development campaigns. More keeps more candidates at the cost of time.
"""

# --- posterior ------------------------------------------------------------------------------

PRIOR_NO_GAP = 0.5
"""Prior probability of an exact base model and nothing else.

Source: indifference. It changes the advice on the next test, and whether a rare campaign is a gap.
"""

PRIOR_OF_SET_SIZE = {1: 0.40, 2: 0.15, 3: 0.05}
"""Prior probability, given a gap, that so many listed effects cause it; sets of a size are alike.

Source: chosen; each further cause is rarer by a factor of about three.
"""

PRIOR_BASE_DISCREPANCY = 0.30
"""Prior probability, given a gap, that the base model is a little off and nothing else.

Source: chosen; no model is exact, so it is nearly as likely as a single cause.
"""

PRIOR_UNLISTED = 0.10
"""Prior probability of an unlisted cause alone, given a gap; of one in addition, given a set.

Source: chosen. More makes the verdict `unexplained` more frequent.
"""

PRIOR_FORM_ERROR = 0.5
"""Prior probability that what the forms of a set miss looks like one of the other effects.

Source: indifference.
"""

RELEVANT_PROBABILITY = 0.01
"""Probability below which an explanation is left out of predictions, and an effect of reports.

Source: chosen, for speed and the length of the report.
"""

# --- verdict and summary --------------------------------------------------------------------

CAUSE_FOUND_PROBABILITY = 0.80
"""Probability from which one set is a found cause, and that a credible set of effects holds.

Source: chosen. More makes the verdict `ambiguous` more frequent.
"""

PRESENT_PROBABILITY = 0.95
"""Inclusion probability from which an effect is a cause, whatever company it has.

Source: convention. On development campaigns of listed effects 31 of 36 such members were hidden.
"""

REPORTED_MEMBER = 0.05
"""Inclusion probability from which a member is reported.

Source: length of the report.
"""

MAX_MEMBERS = 6
"""Maximum number of members that are reported.

Source: length of the report.
"""

OTHER_FORM_FRACTION = 0.5
"""Minimum fraction of the squared change by an effect that acts in a form not in the list.

Source: `LIKELY`; below it, what is not listed makes more of the change than the effect does.
"""

AT_BOUND_FRACTION = 1e-3
"""Fraction of its range within which a size or a base parameter counts as at its bound.

Source: chosen; a refit ends at a bound to about 1e-6 of the range.
"""

EXCEEDED_DEVIATIONS = 3.0
"""Standard errors beyond its bound from which the readings ask for a shape that no source gives.

Source: three sigma; the estimate is linear near the bound, so that two would be too sure.
"""

SHRINKAGE_TAIL = 0.025
"""Probability beyond each end of that interval.

Source: 95 % interval.
"""

# --- design ---------------------------------------------------------------------------------

SETTLED_PROBABILITY = 0.95
"""Probability at which an explanation is settled and no further test is advised.

Source: convention.
"""

DESIGN_EXPLANATIONS = 8
"""Maximum number of explanations between which tests are chosen.

Source: limit of computing time.
"""

DESIGN_TESTS = 4
"""Tests that are chosen at once.

Source: length of the report.
"""

MIN_TEST_GAIN = 0.02
"""Information of the readings of a test [nats] below which it is not worth making.

Source: chosen; some 200 such tests would be needed to settle even odds.
"""

SAME_TEST_FRACTION = 0.2
"""Fraction of the range of the possible tests, along every axis, that makes two neighbours.

Source: chosen; one step of the grids of candidate tests.
"""

NOTHING_NEW_FRACTION = 0.9
"""Fraction of the gain of a test from which repeating a neighbour chosen before does as well.

Source: chosen.
"""

MANY_TESTS = 100.0
"""Tests, evenly spread, after which explanations that are still alike cannot be separated by tests.

Source: chosen; a larger campaign is rarely run.
"""

DECISIVE_SQUARED_DEVIATIONS = 9.0
"""Squared deviations from which an effect is visible, or distinguishable from another.

Source: three deviations.
"""

MAX_PLAN_RUNS = 20
"""Repetitions of a plan up to which a report states how many would show an effect.

Source: chosen; more are rarely run.
"""

# --- summary of effects ---------------------------------------------------------------------

MAX_CAUSES = 6
"""Maximum number of causes reported.

Source: length of the report.
"""

MAX_CAUSES_UNEXPLAINED = 3
"""Maximum number of causes reported where none of them explains the gap.

Source: length of the report.
"""

WITHIN_CLASS_DEVIATIONS = 2.0
"""Prior deviations of the error of a meter up to which an effect is no more than that error.

Source: 95 % of the meters of a class are within.
"""

INTERVAL_DEVIATIONS = 1.96
"""Standard errors on either side of a size in its interval.

Source: 95 % interval of a normal variable.
"""

MIN_SHRINKAGE = -10.0
"""Smallest fraction removed that is reported; how much further a gap grows is of no use.

Source: chosen; it keeps the ends of intervals finite.
"""

NOISE_AS_STATED = (0.75, 1.33)
"""Ratio of estimated to stated noise between which the statement is not commented on.

Source: chosen.
"""

PARAMETER_FAR_OFF = 4.0
"""Deviations of a base parameter from its prior mean, in prior deviations, from which it is named.

Source: chosen; by chance one parameter in 16,000.
"""

METER_FAR_OFF = 3.0
"""Ratio of estimated to assumed noise of a further channel from which its meter is named.

Source: chosen; meters of one kind differ less between makers.
"""
