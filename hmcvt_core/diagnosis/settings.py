# Copyright The hmcvt developers. SPDX-License-Identifier: Apache-2.0
"""Every threshold, prior and count of the diagnosis, with its source and what it changes.

"Development campaigns" are simulated campaigns whose seeds the published blind trial does not use.
Parts are fractions, deviations are standard deviations of one reading, sizes are in typical sizes of
an effect, and log evidence is in nats.
"""

import math

# --- observations ---------------------------------------------------------------------------

SMALL_CAMPAIGN = 16
"""Samples below which scatter has no shape to judge by, only a size.

Source: chosen on development campaigns. Below it, stated noise is believed and outliers are kept.
"""

MOST_SAMPLES = 1000
"""Most samples of a campaign that are used.

Source: limit of computing time. More samples give finer regions, at a cost that grows linearly.
"""

REPLICATE_TOLERANCE = 0.002
"""Part of the range of an axis within which points count as repeats of one point.

Source: chosen on development campaigns; set points of real benches repeat within 0.1 %.
"""

REPLICATES_NEEDED = 5
"""Degrees of freedom of repeated points from which they state the noise.

Source: chosen on development campaigns. With fewer, the assumed noise is used instead.
"""

LEAST_REPLICATE_NOISE = 1e-5
"""Part of the largest reading below which agreement of repeats is a copy, not a measurement.

Source: resolution of torque meters. A lower value lets copied rows state a noise of zero.
"""

SMOOTH_DEGREE = 3
"""Total degree of the polynomials that count as smooth over the operating points of a campaign.

Source: chosen on development campaigns. A higher degree lets smooth discrepancies follow narrow gaps.
"""

PRIOR_DOF_STATED = 8.0
"""Prior degrees of freedom of a noise that is stated for a channel.

Source: chosen on development campaigns. More makes a wrong statement harder to correct.
"""

PRIOR_DOF_ASSUMED = 1.0
"""Prior degrees of freedom of a noise that nobody states.

Source: one sample, the weakest proper statement.
"""

PRIOR_DOF_STATED_SMALL = 30.0
"""Prior degrees of freedom of a stated noise in a campaign below `SMALL_CAMPAIGN`.

Source: chosen on development campaigns; so few samples cannot correct a statement.
"""

PRIOR_DOF_ASSUMED_SMALL = 3.0
"""Prior degrees of freedom of an assumed noise in a campaign below `SMALL_CAMPAIGN`.

Source: chosen on development campaigns: a bench twice as noisy as assumed raises no alarm by the
size of its scatter, one six times as noisy does.
"""

# --- preparation ----------------------------------------------------------------------------

LEAST_SAMPLES = 5
"""Samples below which no diagnosis is made. Source: one more than the usual base parameters."""

MOST_WITHOUT_ANSWER = 0.25
"""Part of the samples at which the model may have no answer before the campaign is refused.

Source: chosen on development campaigns; more points to wrong units or a wrong model.
"""

NAMED_SAMPLES = 3
"""Samples that a note names one by one. Source: length of a sentence."""

THINNING_REFINEMENT = 1.05
"""Ratio of the resolutions of successive lattices when a campaign is thinned.

Source: limit of computing time. A smaller ratio spreads the kept samples slightly more evenly.
"""

THINNING_FINEST = 250.0
"""Cells along an axis of the finest lattice when a campaign is thinned. Source: computing time."""

OUTLIER_NEIGHBOURS = 6
"""Nearest neighbours with whose residuals that of a sample is compared.

Source: chosen on development campaigns. More neighbours make narrow gaps look like outliers.
"""

OUTLIER_DISTANCE = 5.0
"""Robust deviations from its neighbours from which a sample is an outlier.

Source: chosen on development campaigns: less than one false outlier in 1,000 sound campaigns.
"""

OUTLIER_RATIO = 10.0
"""How many times the largest usual distance an outlier has where many samples lie far off.

Source: chosen on development campaigns; one gross slip bends the fit at other samples.
"""

OUTLIER_LEAST_SCALE = 0.01
"""Deviations that the usual distance is at least; a refit comes no nearer. Source: tolerance of refits."""

OUTLIER_MOST_PART = 0.03
"""Part of the samples that may be outliers; more are a narrow gap.

Source: chosen on development campaigns.
"""

OUTLIER_CLUSTER_P = 0.01
"""p value (Kolmogorov-Smirnov) below which outliers of a large campaign lie together, as a gap does.

Source: chosen on development campaigns.
"""

MAD_TO_DEVIATION = 1.4826
"""Standard deviation of a normal variable by its median absolute deviation. Source: normal quantile."""

UNEVEN_NOISE_ROUNDS = 5
"""Most refits of a variance function of one channel. Source: converged on development campaigns."""

UNEVEN_NOISE_POINTS = 2.0
"""Distinct points for each fitted function from which a variance function is looked for.

Source: chosen on development campaigns.
"""

# --- fitting --------------------------------------------------------------------------------

NO_ANSWER = 100.0
"""Deviations that a hypothesis is charged for each reading that it cannot predict.

Source: more than any misfit; else refits to a large gap drop the points where it is largest.
"""

SIGNATURE_SIZE = 0.1
"""Size at which the signature of an effect is taken, in typical sizes.

Source: refits leave little of an effect, so the slope near zero counts.
"""

INVISIBLE_SIGNATURE = 1e-3
"""Deviations below which an effect of typical size is invisible in every channel. Source: rounding."""

REFIT_STEPS = 60
"""Most steps of a refit. Source: never reached on development campaigns."""

ROUGH_REFIT_STEPS = 6
"""Most steps of a rough refit, as candidates get. Source: chosen on development campaigns for speed."""

STEP_PARTS = (1.0, 0.5, 0.2, 0.05, 0.01)
"""Parts of a Gauss-Newton step that the line search tries, in this order.

Source: chosen on development campaigns.
"""

NEGLIGIBLE_STEP = 0.3
"""Deviations: a step that changes or gains less than this in all is not made.

Source: a change of 0.05 nats; smaller values cost time and change no ranking.
"""

BASE_DIFFERENCE = 1e-5
"""Step of the finite differences by base parameters, in scaled variables. Source: root of rounding."""

SIZE_DIFFERENCE = 1e-3
"""Step of the finite differences by sizes and shapes. Source: rounding of the shaft solver."""

AUXILIARY_VARIANCE_RATIO = 9.0
"""How many times their noise variance channels have that are not served, at least, in the served fit.

Source: three deviations. More makes the served channels fit better at the cost of the others.
"""

SHAPE_PRIOR_MEAN = 0.5
"""Prior mean of a free shape, as part of its range. Source: middle of the range."""

SHAPE_PRIOR_SPREAD = (2.0 * math.pi) ** -0.5
"""Prior deviation of a free shape, as part of its range.

Source: gives a normal prior the density of the uniform one at its middle.
"""

NOISE_ROUNDS = 8
"""Most rounds of the fixed point of noise variances in the evidence. Source: usually three are made."""

NOISE_TOLERANCE = 2e-3
"""Relative change of the noise variances at which that fixed point ends. Source: 0.1 nats of evidence."""

FOLDS = 12
"""Folds of a cross-validation. Source: usual range of 10 to 20; more cost time."""

FOLD_ASSIGNMENTS = 8
"""Random assignments of samples to folds that are averaged.

Source: chosen on development campaigns; the spread over assignments falls with the root of it.
"""

# --- detection ------------------------------------------------------------------------------

GAP_SIGNIFICANCE = 0.02
"""p value up to which a gap counts. Source: chosen; one sound campaign in fifty raises an alarm."""

REGION_SIGNIFICANCE = 0.05
"""Family-wise p value up to which a region is significant by itself. Source: convention."""

NULL_CAMPAIGNS = 999
"""Simulated campaigns without a gap. Source: resolves p values of a thousandth."""

NULL_BATCH = 64
"""Simulated campaigns handled at once. Source: memory."""

REGION_SAMPLES = 4
"""Least samples of a region in a campaign of at least 32. Source: chosen on development campaigns."""

SAMPLES_PER_REGION_SAMPLE = 8
"""Samples of a campaign for each sample that a region needs in a smaller one. Source: the same."""

BAND_EDGES = 21
"""Most edges of bands along one axis. Source: computing time; more give narrower regions."""

CORNER_EDGES = 6
"""Most edges along each axis of boxes over several axes. Source: computing time."""

ABSORBED_PART = 1e-6
"""Part of a squared signature that a refit has to leave for the look to count. Source: rounding."""

REGION_GAIN = 0.05
"""Gain of F1 from which a further region is reported. Source: chosen on development campaigns."""

MOST_REGIONS = 5
"""Most regions reported. Source: readability of the page."""

# --- discrepancy ----------------------------------------------------------------------------

SIZE_SPREADS = (0.5, 1.5, 5.0)
"""Prior deviations of a size, in typical sizes; equally likely.

Source: sizes in the literature lie within a factor of three of the typical one.
"""

SCREENED_SPREAD = 1.5
"""Prior deviation of sizes of a refit that forms are added to in the screen. Source: the middle one."""

FORM_ALLOWANCES = (0.02, 0.07, 0.25)
"""How far a form may bend, smoothly over the operating points, as a part of its own signature.

Equally likely. Source: what families of forms in the literature leave of each other, from power
laws, which agree once their exponents do, to films that break (docs/diagnosis.md).
"""

FORM_ALLOWANCE_DEGREE = 2
"""Total degree of the polynomials by which a form may bend. Source: chosen on development campaigns."""

EXACT_BASE_SPREAD = 1e-6
"""Prior deviation that stands for an exact base model. Source: rounding."""

LEAST_SQUARE_PART = 1e-9
"""Part that is added to squares to keep them from zero. Source: rounding."""

EXTRA_DISCREPANCY_PART = (0.06, 0.2)
"""Part of the squared change by a discrepancy added to a set: none of it up to, all of it from.

Source: the largest form allowance, once (0.25 ** 2) and nearly twice.
"""

MISSED_PART = (0.25, 0.75)
"""Part of the squared change that a set misses by itself: due to its forms up to, decisive from.

Source: the largest form allowance along three axes makes 0.19; three quarters is nearly all.
"""

EXPLAINED_BY_SET = (1.0, 0.01)
"""How far a set explains the gap at the ends of the two ranges above. Source: chosen."""

# --- search ---------------------------------------------------------------------------------

LEADING_SETS = 4
"""Sets of a size that are extended by a further effect. Source: chosen on development campaigns."""

REFITTED_SETS = 6
"""Sets refitted of each group of proposals. Source: chosen on development campaigns, for speed."""

PROPOSED_FORMS = 8
"""Forms that the screen proposes for a set beyond the best of each effect. Source: the same."""

EXCHANGE_ROUNDS = 3
"""Rounds in which effects of leading sets are exchanged. Source: the same."""

EXCHANGED_SETS = 2
"""Leading sets whose effects are exchanged. Source: the same."""

EXCHANGED_FORMS = 2
"""Other forms of an effect that are tried in its stead. Source: the same."""

EXCHANGED_EFFECTS = 1
"""Other effects that are tried in its stead. Source: the same."""

EXACT_REFITS = 5
"""Leading sets refitted exactly at the end. Source: the same."""

EXACT_REFIT_MARGIN = 6.0
"""Log evidence behind the best from which no exact refit is made.

Source: free shapes bring hardly any set 4 nats nearer on development campaigns.
"""

NEAR_BEST_PART = 0.7
"""Part of the best gain in log evidence above which a candidate is kept, less `NEAR_BEST_MARGIN`.

Source: chosen on development campaigns; lower keeps more candidates at the cost of time.
"""

NEAR_BEST_MARGIN = 4.0
"""Log evidence behind that part of the best gain at which a candidate is dropped. Source: the same."""

# --- posterior ------------------------------------------------------------------------------

PRIOR_NO_GAP = 0.5
"""Prior probability of an exact base model and nothing else; the rest is given to a gap.

Source: indifference. It changes `Advice.no_gap` only: the test of significance does not use it.
"""

PRIOR_OF_SET_SIZE = {1: 0.40, 2: 0.15, 3: 0.05}
"""Prior probability, given a gap, that so many listed effects cause it; sets of one size are alike.

Source: chosen; each further cause is rarer by a factor of about three.
"""

PRIOR_BASE_DISCREPANCY = 0.30
"""Prior probability, given a gap, that the base model is a little off and nothing else.

Source: chosen; no model is exact, so nearly as likely as a single cause.
"""

PRIOR_UNLISTED = 0.10
"""Prior probability, given a gap, of an unlisted discrepancy as all of it; the same with each set.

Source: chosen. More makes the verdict `unexplained` more frequent.
"""

BOOTSTRAP_CAMPAIGNS = 400
"""Campaigns drawn from the samples for bagged posteriors (Huggins & Miller 2023).

Source: standard error of a probability below 0.025.
"""

SETS_WITH_DISCREPANCY = 4
"""Leading sets that also compete together with an unlisted discrepancy. Source: computing time."""

REVERSED_EFFECTS = 3
"""Effects that are tried with the sign they cannot have. Source: computing time."""

RELEVANT_PROBABILITY = 0.01
"""Probability below which an explanation is left out of predictions. Source: chosen; saves time."""

# --- verdict and summary --------------------------------------------------------------------

CAUSE_FOUND_PROBABILITY = 0.80
"""Probability from which one set is a found cause, and that a credible set of effects holds.

Source: chosen; more makes the verdict `ambiguous` more frequent.
"""

UNEXPLAINED_PROBABILITY = 0.5
"""Probability of an unlisted discrepancy from which no cause is named. Source: more likely than not."""

RIVAL_SET_MARGIN = math.log(CAUSE_FOUND_PROBABILITY / (1.0 - CAUSE_FOUND_PROBABILITY))
"""Log evidence within which a second set of the same size keeps the verdict `ambiguous`.

Source: the odds of `CAUSE_FOUND_PROBABILITY`.
"""

SUMMARISED_SETS = 5
"""Sets whose shrinkage is reported. Source: computing time."""

SHRINKAGE_DRAWS = 999
"""Bootstrap draws of the interval of a shrinkage. Source: usual."""

SHRINKAGE_TAIL = 0.025
"""Probability beyond each end of that interval. Source: 95 % interval."""

ROUNDING = 1e-9
"""Probability or efficiency that counts as zero. Source: rounding."""

# --- design ---------------------------------------------------------------------------------

SETTLED_PROBABILITY = 0.95
"""Probability at which an explanation is settled and no further test is advised. Source: convention."""

SETTLED_LOG_ODDS = math.log(SETTLED_PROBABILITY / (1.0 - SETTLED_PROBABILITY))
"""Log odds of `SETTLED_PROBABILITY`."""

DESIGN_EXPLANATIONS = 8
"""Explanations between which tests are chosen. Source: computing time."""

DESIGN_TESTS = 4
"""Tests chosen at once. Source: readability."""

MANY_TESTS = 100.0
"""Tests, evenly spread, that could not tell two explanations apart if none can. Source: chosen."""

DESIGN_MAJORITY = 0.5
"""Probability of explanations that cannot be settled, or carry a test, from which none is advised.

Source: more likely than not.
"""

DECISIVE_SQUARED_DEVIATIONS = 9.0
"""Squared deviations from which an effect is visible or two are distinguishable. Source: three deviations."""

MOST_PLAN_RUNS = 20
"""Repetitions of a plan up to which their number is printed. Source: readability."""

LEAST_GAIN = 1e-9
"""Information of a test [nats] below which it counts as this. Source: rounding."""

# --- summary of effects ---------------------------------------------------------------------

LEAST_CAUSE_PROBABILITY = 0.01
"""Probability from which an effect is reported as a cause. Source: readability."""

MOST_CAUSES = 6
"""Most causes reported. Source: readability."""

MOST_CAUSES_UNEXPLAINED = 3
"""Most causes reported where none of them explains the gap. Source: readability."""

INTERVAL_DEVIATIONS = 1.96
"""Standard errors on either side of a size in its interval. Source: 95 % of a normal."""

LARGEST_PLAUSIBLE_SIZE = 5.0
"""Typical sizes of an effect beyond which a size is reported as implausible.

Source: chosen; the spread of sizes in the literature is about a factor of three.
"""

LEAST_SHRINKAGE = -10.0
"""Smallest fraction removed that is reported; further growth of a gap says nothing more.

Source: chosen; it keeps the ends of intervals finite.
"""

NOISE_AS_STATED = (0.75, 1.33)
"""Ratio of estimated to stated noise between which the statement is not commented on.

Source: chosen; the ratio of one campaign of 30 samples scatters by about 0.13.
"""
