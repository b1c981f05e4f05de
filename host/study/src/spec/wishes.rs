//! What is wanted of a design, and what has to hold.

/// A figure of a design.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Figure {
    /// Peak at the place where the least can be had, in g.
    WeakestG,
    /// The same in dB above the threshold of feeling.
    WeakestDb,
    /// Contrast of a weak touch at a place in dB.
    ContrastDb,
    /// Time in ms in which a touch at a place rises to 90 %: how crisp a click can be.
    RiseMs,
    /// Part of 12 x 8 places (12 of a bar) at which a click of 0.5 g is crisp.
    CrispShare,
    /// Least peak in g of these clicks.
    ClickWeakestG,
    /// Sound in dB of these clicks.
    ClickSoundDb,
    /// Electrical power in W at full safe force.
    PowerW,
    /// Mass of the panel with all that rides on it, in g.
    MassG,
    /// What the parts cost.
    Cost,
    /// Frequency in Hz of the highest mode that is mostly motion as a rigid body.
    RigidModeHz,
    /// Frequency in Hz of the first mode that mostly bends the panel.
    BendingModeHz,
    /// How far the panel yields where it is pressed, at its softest place, in um.
    SagUm,
    /// Highest voltage that is commanded, in V.
    VoltageV,
}

/// Whether more or less is better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WishGoal {
    /// More.
    Most,
    /// Less.
    Least,
}

impl WishGoal {
    /// The word in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Most => "most",
            Self::Least => "least",
        }
    }

    /// A figure as a loss: less is better.
    #[must_use]
    pub const fn loss_of_figure(self, figure: f64) -> f64 {
        match self {
            Self::Most => -figure,
            Self::Least => figure,
        }
    }
}

/// Which settings of the actuators count.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SettingScope {
    /// Each place has a setting of its own.
    EveryTouch,
    /// One setting for the whole surface.
    One,
}

/// How the actuators' frequencies go together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrequencyGrouping {
    /// One for each actuator.
    Distinct,
    /// One for all of them, with phases.
    OneFrequency,
    /// One for all of them, in phase.
    InPhase,
}

impl FrequencyGrouping {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Distinct, Self::OneFrequency, Self::InPhase];

    /// The word in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Distinct => "distinct",
            Self::OneFrequency => "one_frequency",
            Self::InPhase => "in_phase",
        }
    }
}

impl Figure {
    /// All of them.
    pub const ALL: [Self; 14] = [
        Self::WeakestG,
        Self::WeakestDb,
        Self::ContrastDb,
        Self::RiseMs,
        Self::CrispShare,
        Self::ClickWeakestG,
        Self::ClickSoundDb,
        Self::PowerW,
        Self::MassG,
        Self::Cost,
        Self::RigidModeHz,
        Self::BendingModeHz,
        Self::SagUm,
        Self::VoltageV,
    ];

    /// The word in the file.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::WeakestG => "weakest_g",
            Self::WeakestDb => "weakest_db",
            Self::ContrastDb => "contrast_db",
            Self::RiseMs => "rise_ms",
            Self::CrispShare => "crisp_share",
            Self::ClickWeakestG => "click_weakest_g",
            Self::ClickSoundDb => "click_sound_db",
            Self::PowerW => "power_w",
            Self::MassG => "mass_g",
            Self::Cost => "cost",
            Self::RigidModeHz => "rigid_mode_hz",
            Self::BendingModeHz => "bending_mode_hz",
            Self::SagUm => "sag_um",
            Self::VoltageV => "voltage_v",
        }
    }

    /// What is usually wanted of it.
    #[must_use]
    pub const fn default_goal(self) -> WishGoal {
        match self {
            Self::WeakestG
            | Self::WeakestDb
            | Self::ContrastDb
            | Self::CrispShare
            | Self::ClickWeakestG
            | Self::BendingModeHz => WishGoal::Most,
            Self::RiseMs
            | Self::ClickSoundDb
            | Self::PowerW
            | Self::MassG
            | Self::Cost
            | Self::RigidModeHz
            | Self::SagUm
            | Self::VoltageV => WishGoal::Least,
        }
    }

    /// Whether it is about settings of the actuators over the surface.
    #[must_use]
    pub const fn is_evaluated_at_weakest_place(self) -> bool {
        matches!(self, Self::WeakestG | Self::WeakestDb | Self::PowerW | Self::VoltageV)
    }

    /// Whether it is a peak at the place where the least can be had.
    #[must_use]
    pub const fn is_weakest_place_peak(self) -> bool {
        matches!(self, Self::WeakestG | Self::WeakestDb)
    }

    /// Whether it is the frequency of a mode.
    #[must_use]
    pub const fn is_mode_frequency(self) -> bool {
        matches!(self, Self::RigidModeHz | Self::BendingModeHz)
    }

    /// Whether it is about a place.
    #[must_use]
    pub const fn is_evaluated_at_given_touch_place(self) -> bool {
        matches!(self, Self::ContrastDb | Self::RiseMs)
    }

    /// Whether it is a level in dB, which has no ratio to another.
    #[must_use]
    pub const fn is_level_in_db(self) -> bool {
        matches!(self, Self::WeakestDb | Self::ContrastDb | Self::ClickSoundDb)
    }
}

/// A figure with all that it depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct WantedFigure {
    /// Which.
    pub figure: Figure,
    /// For figures of settings: which settings.
    pub setting: SettingScope,
    /// For the weakest place: how it is driven.
    pub drives: FrequencyGrouping,
    /// For figures of a place: where, in mm.
    pub at_mm: Option<[f64; 2]>,
    /// For the sag: the press in N; the scene's if `None`.
    pub force_n: Option<f64>,
}

impl WantedFigure {
    /// Whether it follows from the weakest place of a setting for every touch, or from the parts alone.
    #[must_use]
    pub fn needs_no_plan_table(&self) -> bool {
        match self.figure {
            Figure::WeakestG | Figure::WeakestDb => {
                self.setting == SettingScope::EveryTouch && self.drives == FrequencyGrouping::Distinct
            }
            figure => matches!(figure, Figure::SagUm | Figure::MassG | Figure::Cost),
        }
    }

    /// Whether it is the peak at the weakest place with a setting for every touch, of which a plan has a bound.
    #[must_use]
    pub fn is_weakest_peak_in_g_of_setting_per_touch_at_distinct_frequencies(&self) -> bool {
        self.figure == Figure::WeakestG
            && (self.setting, self.drives) == (SettingScope::EveryTouch, FrequencyGrouping::Distinct)
    }

    /// Whether its relative error has a bound when it is computed thoroughly.
    #[must_use]
    pub fn can_have_error_bound(&self) -> bool {
        self.is_weakest_peak_in_g_of_setting_per_touch_at_distinct_frequencies()
            || self.figure == Figure::SagUm
            || self.figure.is_mode_frequency()
    }

    /// Whether it is about one setting for the whole surface.
    #[must_use]
    pub fn is_for_one_setting_on_whole_surface(&self) -> bool {
        self.figure.is_evaluated_at_weakest_place() && self.setting == SettingScope::One
    }

    /// What tables call it.
    #[must_use]
    pub fn column_name(&self) -> String {
        let mut name = self.figure.name().to_owned();
        if self.is_for_one_setting_on_whole_surface() {
            name.push_str("_one_setting");
        }
        if self.drives != FrequencyGrouping::Distinct {
            name.push('_');
            name.push_str(self.drives.name());
        }
        if let Some([x, y]) = self.at_mm {
            name.push_str(&format!("_at_{x}_{y}"));
        }
        if let Some(force_n) = self.force_n {
            name.push_str(&format!("_{force_n}_n"));
        }
        name
    }
}

/// A figure that is to be large, or small.
#[derive(Clone, Debug, PartialEq)]
pub struct Wish {
    /// Which.
    pub wanted: WantedFigure,
    /// What is better.
    pub goal: WishGoal,
}

/// A figure that has to be within bounds.
#[derive(Clone, Debug, PartialEq)]
pub struct FigureLimit {
    /// Which.
    pub wanted: WantedFigure,
    /// No less than this.
    pub least: f64,
    /// No more than this.
    pub most: f64,
}

impl FigureLimit {
    /// Each of its bounds in words (`sag_um at most 800`), with how far the end of a figure's least and most is beyond it, in the figure's unit: what
    /// is kept is at most 0.
    pub fn bounds_in_words_and_signed_excesses(
        &self,
        low: f64,
        high: f64,
    ) -> impl Iterator<Item = (String, f64)> + use<> {
        let column = self.wanted.column_name();
        let Self { least, most, .. } = *self;
        let least = least.is_finite().then(|| (format!("{column} at least {least}"), least - low));
        let most = most.is_finite().then(|| (format!("{column} at most {most}"), high - most));
        least.into_iter().chain(most)
    }

    /// The end of a figure's least and most that is beyond the limit, and what is allowed; `None` if the limit is kept.
    #[must_use]
    pub fn violating_value_and_allowed_text_if_limit_broken(&self, low: f64, high: f64) -> Option<(f64, String)> {
        if low < self.least {
            Some((low, format!("at least {}", self.least)))
        } else if high > self.most {
            Some((high, format!("at most {}", self.most)))
        } else {
            None
        }
    }
}

/// What parts cost, in a currency of the file's own.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PartCosts {
    /// Each actuator.
    pub actuator: f64,
    /// Each support.
    pub support: f64,
    /// Each point mass.
    pub mass: f64,
    /// Each kg of the surface.
    pub per_kg: f64,
}
