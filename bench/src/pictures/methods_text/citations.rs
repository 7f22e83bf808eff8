//! References of the metrics and their networks.

/// A work to cite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Citation {
    Ssim,
    Lpips,
    Dists,
    AlexNet,
    Vgg,
    SqueezeNet,
}

impl Citation {
    /// Its key.
    pub(super) fn key(self) -> &'static str {
        match self {
            Self::Ssim => "wang2004image",
            Self::Lpips => "zhang2018unreasonable",
            Self::Dists => "ding2022image",
            Self::AlexNet => "krizhevsky2014one",
            Self::Vgg => "simonyan2015very",
            Self::SqueezeNet => "iandola2016squeezenet",
        }
    }

    /// Its entry, which ends in a line break.
    pub(super) fn bibtex(self) -> &'static str {
        match self {
            Self::Ssim => {
                "@article{wang2004image,\n  \
                 author = {Wang, Zhou and Bovik, Alan C. and Sheikh, Hamid R. and Simoncelli, Eero P.},\n  \
                 title = {Image Quality Assessment: From Error Visibility to Structural Similarity},\n  \
                 journal = {IEEE Transactions on Image Processing},\n  \
                 volume = {13}, number = {4}, pages = {600--612}, year = {2004}\n}\n"
            }
            Self::Lpips => {
                "@inproceedings{zhang2018unreasonable,\n  \
                 author = {Zhang, Richard and Isola, Phillip and Efros, Alexei A. and Shechtman, Eli and Wang, Oliver},\n  \
                 title = {The Unreasonable Effectiveness of Deep Features as a Perceptual Metric},\n  \
                 booktitle = {CVPR},\n  \
                 pages = {586--595}, year = {2018}\n}\n"
            }
            Self::Dists => {
                "@article{ding2022image,\n  \
                 author = {Ding, Keyan and Ma, Kede and Wang, Shiqi and Simoncelli, Eero P.},\n  \
                 title = {Image Quality Assessment: Unifying Structure and Texture Similarity},\n  \
                 journal = {IEEE Transactions on Pattern Analysis and Machine Intelligence},\n  \
                 volume = {44}, number = {5}, pages = {2567--2581}, year = {2022}\n}\n"
            }
            Self::AlexNet => {
                "@article{krizhevsky2014one,\n  \
                 author = {Krizhevsky, Alex},\n  \
                 title = {One Weird Trick for Parallelizing Convolutional Neural Networks},\n  \
                 journal = {arXiv:1404.5997}, year = {2014}\n}\n"
            }
            Self::Vgg => {
                "@inproceedings{simonyan2015very,\n  \
                 author = {Simonyan, Karen and Zisserman, Andrew},\n  \
                 title = {Very Deep Convolutional Networks for Large-Scale Image Recognition},\n  \
                 booktitle = {ICLR}, year = {2015}\n}\n"
            }
            Self::SqueezeNet => {
                "@article{iandola2016squeezenet,\n  \
                 author = {Iandola, Forrest N. and Han, Song and Moskewicz, Matthew W. and Ashraf, Khalid and Dally, \
                 William J. and Keutzer, Kurt},\n  \
                 title = {{SqueezeNet}: {AlexNet}-Level Accuracy with 50x Fewer Parameters and {$<$0.5MB} Model Size},\n  \
                 journal = {arXiv:1602.07360}, year = {2016}\n}\n"
            }
        }
    }
}
